"""What stops a command."""


class CommandError(Exception):
    """Bad data or a file that cannot be used: one line for the user, no traceback."""
