"""Exception classes of the printer link: port, handshake, job, journal, refused requests.

::

    LinkError                   anything that keeps a print from starting or ends it
    ├── PortError               the port, by name
    │   ├── PortMissing         no such port
    │   ├── PortDenied          no right to open it
    │   ├── PortInUse           another program holds it
    │   └── PortLost            it went away while in use
    │       └── HostSilent      a network host doesn't answer
    ├── HostRefused             a network host answers that it won't, or can't
    ├── HandshakeError          the port opened, no firmware of the profile's family answered
    ├── PrintChanged            flow or speed was changed at the printer's panel while it printed
    ├── JobError                a line that must not be sent
    ├── JournalError            a journal that can't be written or isn't one
    ├── AlreadyPrinting         a link process already owns this folder
    ├── HistoryError            the index of past prints can't be used
    │   └── NoSuchPrint         no print, or more than one, has that id
    ├── Refused                 a request that can't be granted as the print stands; it goes on
    └── NoLink                  nothing to attach to, or the link process doesn't answer
"""

from __future__ import annotations


class LinkError(RuntimeError):
    """Base of the link's errors; the message says what, where and the remedy."""


class PortError(LinkError):
    """A port that can't be used."""


class PortMissing(PortError):  # noqa: N818 (named after what is wrong)
    """No port of that name."""


class PortDenied(PortError):  # noqa: N818
    """The user may not open the port."""


class PortInUse(PortError):  # noqa: N818
    """Another program holds the port."""


class PortLost(PortError):  # noqa: N818
    """The port went away while in use."""


class HostSilent(PortLost):
    """A network host didn't answer in time, or the connection broke.

    Attributes
    ----------
    sent : bool
        Whether any byte of the request may have left, so that the host may have carried it out.
    """

    def __init__(self, message: str, sent: bool = True) -> None:
        super().__init__(message)
        self.sent = sent


class HostRefused(LinkError):  # noqa: N818
    """A network host's answer that it won't, or can't.

    Attributes
    ----------
    status : int
        Of HTTP; 0 where the answer was wrong in another way.
    """

    def __init__(self, message: str, status: int = 0) -> None:
        super().__init__(message)
        self.status = status


class HandshakeError(LinkError):
    """Nobody of the expected firmware family answered."""


class PrintChanged(LinkError):  # noqa: N818
    """Flow or speed was changed at the printer's panel, so a part isn't as it was checked."""


class JobError(LinkError):
    """A job with a line that must not be sent."""


class JournalError(LinkError):
    """A journal that can't be used."""


class AlreadyPrinting(LinkError):  # noqa: N818
    """The folder belongs to a link process that is alive."""


class HistoryError(LinkError):
    """The history of prints can't be used."""


class NoSuchPrint(HistoryError):  # noqa: N818
    """No print, or more than one, has that id."""


class Refused(LinkError):  # noqa: N818
    """A request that can't be granted as the print stands: a mistake of the user's."""


class NoLink(LinkError):  # noqa: N818
    """There is no link process to talk to."""


BY_NAME: dict[str, type[LinkError]] = {
    kind.__name__: kind
    for kind in (
        LinkError,
        PortError,
        PortMissing,
        PortDenied,
        PortInUse,
        PortLost,
        HostSilent,
        HostRefused,
        HandshakeError,
        PrintChanged,
        JobError,
        JournalError,
        AlreadyPrinting,
        Refused,
        NoLink,
    )
}
"""For the client, which hears of an error by its name over the socket."""
