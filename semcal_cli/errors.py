"""The errors that semcal raises on purpose. Anything else that escapes is a bug."""


class SemcalError(Exception):
    """Root of the tree, caught once, in the command line. Its text is one line for the user."""


class InputError(SemcalError):
    """A file or an option is wrong, and the user can mend it."""


class CalibrationError(SemcalError):
    """The data cannot give an answer."""
