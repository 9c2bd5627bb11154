"""How errors are told: the same text over REST and WebSocket, and a status for REST."""

from __future__ import annotations

import errno
import logging

from re3.apps.server.limits import OverLimitError
from re3.apps.server.playing import TrackingFailedError
from re3.apps.server.wire import Head

DISK_FULL = (errno.ENOSPC, errno.EDQUOT)

_OVER_LIMIT = {"sessions": 429, "objects": 409}
"""HTTP status by kind of limit; of the others 413."""

_log = logging.getLogger(__name__)


class NotReadyError(RuntimeError):
    """The session has no video yet, or not the kind asked for."""


def status(error: Exception) -> int:
    """The HTTP status of an error."""
    match error:
        case OverLimitError():
            return _OVER_LIMIT.get(error.kind, 413)
        case NotReadyError():
            return 409
        case ValueError():
            return 422
        case KeyError():
            return 404
        case OSError() if error.errno in DISK_FULL:
            return 507
    return 500


def told(error: Exception) -> str:
    """What is wrong and what to do, without a path of the server."""
    match error:
        case KeyError():
            return str(error.args[0])
        case ValueError() | NotReadyError() | TrackingFailedError():
            return str(error)
        case OSError() if error.errno in DISK_FULL:
            return (
                "the disk of the computer that runs re3 is full; remove files there or end other "
                "sessions, and try again"
            )
        case OSError():
            return (
                f"the computer that runs re3 cannot do this: {error.strerror or 'input or output'}"
                "; look at its disk and temporary folder, and try again"
            )
    return (
        f"an error inside re3 ({type(error).__name__}), described in the terminal of re3 serve; "
        "the session goes on"
    )


def problem(error: Exception) -> Head:
    """The error as WebSocket messages and JSON answers have it; a bug goes to the log as well."""
    if not isinstance(error, OSError | ValueError | KeyError | NotReadyError | TrackingFailedError):
        _log.error("error inside re3", exc_info=error)
    return {
        "error": told(error),
        "limit": error.kind if isinstance(error, OverLimitError) else None,
    }
