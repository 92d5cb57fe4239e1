"""Access to the view: the Host header, the token, and the headers of every answer."""
import hmac
import ipaddress
from typing import Collection, Mapping

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
BEARER = "Bearer "


def host_allowed(header: str, names: Collection[str]) -> bool:
    """Return whether a Host header names this server: by address, as `localhost` or by own name.

    Another name is one that somebody else gives to our address, to make a browser read what only
    the people at this computer may (DNS rebinding).
    """
    host = header.strip().lower()
    host = host[1 : host.index("]")] if host.startswith("[") and "]" in host else _no_port(host)
    if host in ("localhost", *(name.lower() for name in names)):
        return True
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _no_port(host: str) -> str:
    name, colon, port = host.rpartition(":")
    return name if colon and port.isdigit() else host


def token_given(header: str, token: str) -> bool:
    """Return whether an Authorization header has the token, in a time that tells nothing of it."""
    if not token or not header.startswith(BEARER):
        return False
    return hmac.compare_digest(header[len(BEARER) :].encode(), token.encode())
