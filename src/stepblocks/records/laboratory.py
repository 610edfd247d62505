"""What only the laboratory knows of a certificate, read from its ``lab.toml``."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, Field

from stepblocks.errors import MetrologyError
from stepblocks.files.text import read_document
from stepblocks.mistakes import validate_file_data
from stepblocks.quantities import make_quantity_parser

_Text = Annotated[str, Field(min_length=1, max_length=200)]
_Date = Annotated[str, Field(pattern=r"^\d{4}-[01]\d-[0-3]\d$")]
_Ratio = Annotated[float, Field(ge=0.0, lt=1.0), BeforeValidator(make_quantity_parser("ratio"))]
_Length = Annotated[float, Field(ge=0.0, lt=1e-3), BeforeValidator(make_quantity_parser("length"))]
_Temperature = Annotated[
    float, Field(gt=273.0, lt=323.0), BeforeValidator(make_quantity_parser("temperature"))
]
_Spread = Annotated[
    float, Field(ge=0.0, lt=20.0), BeforeValidator(make_quantity_parser("temperature"))
]
_Angle = Annotated[float, Field(ge=0.0, lt=3.14), BeforeValidator(make_quantity_parser("angle"))]


class InstrumentRecord(BaseModel, frozen=True, extra="forbid"):
    """The instrument, its own certificate, and what that states.

    Attributes
    ----------
    name, serial, certificate : str
        Of the instrument; its serial number, and the number of its certificate.
    calibrated : date
        When it was calibrated.
    calibration, lateral_calibration : float or None
        Relative standard uncertainties of the vertical and the lateral scale [1].
    resolution : float
        Least difference of height that it shows [m].
    stylus_radius, stylus_cone : float or None
        Radius [m] and full angle [rad] of the stylus.
    """

    name: _Text
    serial: _Text
    certificate: _Text
    calibrated: _Date
    calibration: _Ratio | None = None
    lateral_calibration: _Ratio | None = None
    resolution: _Length = 0.0
    stylus_radius: _Length | None = None
    stylus_cone: _Angle | None = None


class Laboratory(BaseModel, frozen=True, extra="forbid"):
    """Laboratory, instrument, conditions, dates and signer of a certificate.

    Attributes
    ----------
    name, address, country : str
        Of the laboratory; the country by the two letters of ISO 3166.
    signer : str
        Who answers for the certificate.
    instrument : InstrumentRecord
        The instrument, its certificate and its calibration.
    temperature, temperature_spread : float
        Of the room [K], and by how much it varied [K].
    measured_from, measured_to : date
        When the part was measured.
    certificate : str
        Number of the certificate; of several parts the first part of their numbers.
    customer, customer_address, serial : str
        Of the customer and of the part, where they are known.
    issued : date or None
        When the certificate is issued.
    """

    name: _Text
    address: _Text
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")]
    signer: _Text
    instrument: InstrumentRecord
    temperature: _Temperature
    temperature_spread: _Spread
    measured_from: _Date
    measured_to: _Date
    certificate: _Text
    customer: Annotated[str, Field(max_length=200)] = ""
    customer_address: str = ""
    issued: _Date | None = None
    serial: str = ""


def read_laboratory(path: str | Path) -> Laboratory:
    """Read what only the laboratory knows of a certificate.

    Parameters
    ----------
    path : str or Path
        TOML file with the fields of `Laboratory`; lengths, ratios, angles and temperatures with
        their units.

    Returns
    -------
    Laboratory
        Lengths in m, temperatures in K, angles in rad.

    Raises
    ------
    MetrologyError
        With all mistakes of the file at once.
    """
    path = Path(path)
    document = read_document(path, "laboratory", MetrologyError)
    laboratory = validate_file_data(Laboratory, document, path, MetrologyError)
    if laboratory.measured_to < laboratory.measured_from:
        raise MetrologyError(
            f"measured_to must not lie before measured_from, got {laboratory.measured_from} to "
            f"{laboratory.measured_to} [{path}]"
        )
    return laboratory
