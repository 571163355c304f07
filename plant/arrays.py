"""The array that physics is made of."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
