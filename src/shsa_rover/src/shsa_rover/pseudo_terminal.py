"""A serial line in software: a pseudo-terminal under a name of its own."""
import errno
import os
import secrets
import select
import stat
import tty

from shsa_core.errors import ShsaError

READ_BYTES = 4096


class PseudoTerminal:
    """The device's end of a serial line.

    The other end is opened at `link` like any serial port.

    Writing never blocks. As on a UART, bytes are lost while nobody has the port open or when the
    reader is too slow. Raises ShsaError if something other than a symbolic link lies at `link`.
    """

    def __init__(self, link: str) -> None:
        self.link = link
        self.lost_bytes = 0
        if os.path.lexists(link) and not stat.S_ISLNK(os.lstat(link).st_mode):
            raise ShsaError(f"{link}: exists and is not a symbolic link; choose another port")
        self._master, port = os.openpty()
        tty.setraw(port)
        self._port = os.ttyname(port)
        # Only without an end of our own does the kernel tell (POLLHUP) that nobody has the port
        # open.
        os.close(port)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, 0)
        temporary = f"{link}.{secrets.token_hex(8)}"  # nobody has put anything there before
        try:
            os.symlink(self._port, temporary)
            os.replace(temporary, link)
        except OSError as error:
            os.close(self._master)
            raise ShsaError(f"{link}: cannot be made: {error.strerror}") from error

    @property
    def connected(self) -> bool:
        """Return whether somebody has the port open."""
        return not any(events & select.POLLHUP for _, events in self._poll.poll(0))

    def write(self, data: bytes) -> int:
        """Sends what the line takes now; returns the number of bytes sent."""
        sent = 0
        if self.connected:
            try:
                sent = os.write(self._master, data)
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EIO):
                    raise
        self.lost_bytes += len(data) - sent
        return sent

    def read(self) -> bytes:
        """Return what has come; nothing if there is nothing."""
        try:
            return os.read(self._master, READ_BYTES)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            return b""

    def close(self) -> None:
        """Unplugs the line and removes the link, unless another has taken it over."""
        os.close(self._master)
        if os.path.islink(self.link) and os.readlink(self.link) == self._port:
            os.unlink(self.link)
