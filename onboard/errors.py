"""The one error of which a command shows only the message."""


class UserError(Exception):
    """Something the user can mend: a flag, a file, a port. The message is one line that says where and how."""
