"""What is raised for picture files."""

from z2p_core.errors.messages import UserError


class PictureError(UserError):
    """A picture file that cannot be used; the message says what was expected, what was found, and what to do."""
