"""What one drag has shown: its trace, its ring and its events, beside equation (1)."""

from dataclasses import asdict, dataclass, fields
from functools import cached_property

import pandas as pd

from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.drag.events import list_surface_events
from stepblocks.drag.probe import Setting
from stepblocks.drag.ring import Ring, measure_ring
from stepblocks.drag.simulate import DragEvent, DragTrace


@dataclass(frozen=True, repr=False)
class DragResult:
    """The results of a drag; `stepblocks.drag.run.Drag` says what each field is."""

    title: str
    trace: DragTrace
    formula: Release
    tool: Tool = PAPER.tool
    setting: Setting | None = None
    backward: bool = False
    within: tuple[float, float] | None = None
    ball_radius: float = PAPER.ball_radius

    @cached_property
    def ring(self) -> Ring | None:
        """The vibration after the release that was asked about; None where there was none."""
        if self.trace.status is not Status.RELEASES:
            return None
        return measure_ring(self.trace)

    @cached_property
    def events(self) -> pd.DataFrame:
        """Every place that the tip came to, one row each.

        The columns are the fields of `DragEvent`.
        """
        columns = [field.name for field in fields(DragEvent)]
        events = list_surface_events(self.trace, self.backward, self.within)
        frame = pd.DataFrame([asdict(event) for event in events], columns=columns)
        for name in ("status", "belongs_to"):  # plain texts in place of enumerations
            frame[name] = [getattr(event, name).value for event in events]
        return frame
