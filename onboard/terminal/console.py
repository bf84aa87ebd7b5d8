"""The console of commands that print figures and tables."""

from typing import Any

import rich.console
from rich.text import Text

from onboard.messages.text import MAX_LINE_LENGTH, plain


class Console(rich.console.Console):
    """Rich's, to which all text is text: square brackets in it are no styles, and what came from outside, such as
    a file's name, controls no terminal."""

    def render_str(self, text: str, **options: Any) -> Text:
        """A string, also of a table's cell, as it is drawn."""
        lines = "\n".join(plain(line, MAX_LINE_LENGTH) for line in text.split("\n"))
        return super().render_str(lines, **{**options, "markup": False, "emoji": False})
