"""Numba's types of what `kinds` describes, and back."""

from typing import Any, Final

import numba

from onboard.compiled.kinds import BOOL, FLOAT, INT, UNSIGNED, ArrayKind, RecordKind

types: Any = numba.types
NUMBERS: Final = {FLOAT: types.float64, INT: types.int64, UNSIGNED: types.uint64, BOOL: types.boolean}
LETTERS: Final = {kind: letter for letter, kind in NUMBERS.items()}


def numba_type(kind: Any) -> Any:
    """The type of an argument."""
    if isinstance(kind, ArrayKind):
        layout, readonly = ("A" if kind.layout in "am" else "C"), kind.layout in "ac"
        return types.Array(NUMBERS[kind.element], kind.ndim, layout, readonly=readonly)
    if isinstance(kind, RecordKind):
        fields = [numba_type(field) for field in kind.fields]
        return types.BaseTuple.from_types(fields, None if kind.of is tuple else kind.of)
    return NUMBERS[kind]


class Specification:
    """Types in the form that `boundary.c` reads, and their classes, the first of them `tuple`."""

    def __init__(self) -> None:
        self.classes: list[type] = [tuple]

    def of(self, kind: Any) -> str:
        """The specification of an argument or a result. Raises TypeError for an unsupported type."""
        if isinstance(kind, types.Array):
            layouts = "wm" if kind.mutable else "ca"  # of one without gaps, and of any other
            return f"A{LETTERS[kind.dtype]}{kind.ndim}{layouts[kind.layout != 'C']}"
        if isinstance(kind, types.BaseTuple):
            of = getattr(kind, "instance_class", tuple)
            if of not in self.classes:
                self.classes.append(of)
            inner = "".join(self.of(each) for each in kind.types)
            return f"({chr(48 + self.classes.index(of))}{chr(48 + len(kind))}{inner}"
        if isinstance(kind, types.NoneType):
            return "n"
        kind = types.unliteral(kind)
        if kind not in LETTERS:
            raise TypeError(f"{kind} cannot pass between Python and machine code")
        return LETTERS[kind]

    def class_names(self) -> str:
        """All but the first, as "module:name"."""
        return " ".join(f"{one.__module__}:{one.__qualname__}" for one in self.classes[1:])
