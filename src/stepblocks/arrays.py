"""Names of types of arrays."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Number = TypeVar("Number", float, NDArray[np.float64])  # one number or an array of them
