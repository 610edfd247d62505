"""What is felt: critical angle, forces and vibration energy of a ball dragged over a surface."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
