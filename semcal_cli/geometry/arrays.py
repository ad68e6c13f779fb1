"""The names of array types, each once. A name says what the rows are; the shape stands where an array is described."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
"""Array of any type."""
Numbers: TypeAlias = NDArray[np.float64]
"""Numbers of any shape."""
Vector: TypeAlias = NDArray[np.float64]
"""(3,) coordinates."""
Vectors: TypeAlias = NDArray[np.float64]
"""(N, k) one vector a row."""
Rays: TypeAlias = NDArray[np.float64]
"""(N, 3) unit directions."""
TwistVector: TypeAlias = NDArray[np.float64]
"""(6,) xi = (rho, phi): translation in metres, then rotation in radians."""
Pose: TypeAlias = NDArray[np.float64]
"""(4, 4) rigid transform, metres."""
Matrix: TypeAlias = NDArray[np.float64]
"""(n, m) matrix."""
Matrices: TypeAlias = NDArray[np.float64]
"""(N, n, m) matrices."""
Points: TypeAlias = NDArray[np.float32]
"""(N, 3) points as they are read, metres, LiDAR frame."""
Values: TypeAlias = NDArray[np.float32]
"""Values of points or pixels, such as ranges."""
Features: TypeAlias = NDArray[np.float16]
"""(N, C) or (H, W, C) feature vectors."""
Image: TypeAlias = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) colour image."""
RawPixels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
"""(H, W) or (H, W, 3) pixels of a recording, 8 or 16 bits."""
ClassIds: TypeAlias = NDArray[np.uint8]
"""Class of each point (N,) or pixel (H, W)."""
RawIds: TypeAlias = NDArray[np.uint16]
"""Class of each point (N,) or pixel (H, W) as the labels state it."""
Colors: TypeAlias = NDArray[np.uint8]
"""(N, 3) colours."""
Mask: TypeAlias = NDArray[np.bool_]
"""Whether something holds, for each point or pixel."""
