"""The console of commands that print figures and tables."""

from typing import Any

import rich.console
from rich.text import Text

from onboard.messages.text import MAX_LINE_LENGTH, plain


class Console(rich.console.Console):
    """Rich's console without markup, so that brackets are text and file names are harmless."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a string, also that of a table's cell."""
        lines = "\n".join(plain(line, MAX_LINE_LENGTH) for line in text.split("\n"))
        return super().render_str(lines, **{**options, "markup": False, "emoji": False})
