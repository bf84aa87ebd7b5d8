"""Units that are not SI, as factors."""

from typing import Final

NS_PER_S: Final = 1_000_000_000
S_PER_NS: Final = 1e-9
