"""Errors of the client; each message names what, where, and what to do next."""

from pathlib import Path

from gaitd_texts import Reader, catalogue

from gaitd_client.wire import Reply


class ClientError(Exception):
    """Base of all errors of this library."""


class CredentialsError(ClientError):
    """A file of credentials cannot be used: `path`, and why."""

    def __init__(self, path: Path, reason: str) -> None:
        """Make the message of both."""
        super().__init__(f"{path}: {reason}")
        self.path, self.reason = path, reason


class EndpointError(ClientError):
    """No service can listen on this endpoint."""


class NoServiceError(ClientError):
    """No service listens on the endpoint, or it does not accept these credentials."""


class NoAnswerError(ClientError):
    """The service did not answer, or with something that is no answer: the outcome is unknown."""


class NotReturnedError(ClientError):
    """A function that was given to this library does not return; its thread is left behind."""


class RequestRefusedError(ClientError):
    """The service has refused a request; `reply.refusal` says why."""

    def __init__(self, reply: Reply) -> None:
        """Say in English what the reply says by code; `texts` has other languages."""
        super().__init__(f"{reply.request}: {reason_of(reply)}")
        self.reply = reply


def reason_of(reply: Reply) -> str:
    """Return in English why a request is not done; empty if it is."""
    return "" if reply.refusal is None else catalogue(Reader.OPERATOR, "en").refusal(reply.refusal)
