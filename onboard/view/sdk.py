"""Import of Rerun, with an error that says how to install it.

The package imports `rr` and `rrb` from here.
"""

from onboard import UserError, with_extra

__all__ = ["MissingRerunError", "rr", "rrb"]


class MissingRerunError(UserError, ImportError):
    """The optional dependency of the live view is not installed."""


try:
    import rerun as rr
    import rerun.blueprint as rrb
except ModuleNotFoundError as error:
    raise MissingRerunError(
        f"the live view needs Rerun, which is not installed ({error}): {with_extra('view')}"
    ) from error
