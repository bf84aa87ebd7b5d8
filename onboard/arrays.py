"""The type of every array of numbers. Types of arrays in compiled signatures are in `onboard.compiled`."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
