"""A table of the services of a robot, and what is to be said of the one that is selected."""
from typing import Any, Dict, List, Optional

from python_qt_binding.QtCore import Qt, QTimer, QUrl
from python_qt_binding.QtGui import QColor, QDesktopServices
from python_qt_binding.QtNetwork import QNetworkAccessManager, QNetworkReply, QNetworkRequest
from python_qt_binding.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from shsa_rqt.events import Events
from shsa_view.glance import Sort, ordered, value

ADDRESS = "http://127.0.0.1:8080/"
RETRY_MS = 2000
SILENCE_MS = 12000
"""After that a view is asked anew: it gives a sign of life each 5 s."""
COLUMNS = ("State", "Service", "Value", "Publisher", "Rate")
COLOURS: Dict[str, QColor] = {
    **dict.fromkeys(("substituted", "returning", "healing"), QColor("#0072b2")),
    **dict.fromkeys(("not_healed", "failed", "kept"), QColor("#b33000")),
}


class Widget(QWidget):
    """Shows the robot of the live view at `address`."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("SelfHealing")
        self.setWindowTitle("Self-healing")
        self._network = QNetworkAccessManager(self)
        self._reply: Optional[QNetworkReply] = None
        self._events = Events()
        self._rows: Dict[str, QTreeWidgetItem] = {}
        self._states: Dict[str, str] = {}
        self._retry = QTimer(self, singleShot=True)
        self._retry.timeout.connect(self._connect)
        self._address = QLineEdit(ADDRESS)
        self._address.setToolTip("Address of the live view")
        self._address.returnPressed.connect(self._connect)
        self._robot = QLabel("Press Enter in the address to connect.", wordWrap=True)
        self._table = QTreeWidget(rootIsDecorated=False, uniformRowHeights=True)
        self._table.setHeaderLabels(COLUMNS)
        self._table.currentItemChanged.connect(self._tell)
        self._told = QLabel(wordWrap=True)
        for label in (self._robot, self._told):
            label.setTextFormat(Qt.PlainText)  # names come from outside
        self._lay_out()

    def _lay_out(self) -> None:
        browser = QPushButton("Browser", toolTip="Open the live view")
        browser.clicked.connect(lambda: QDesktopServices.openUrl(QUrl(self.address)))
        head = QHBoxLayout()
        for each in (QLabel("View"), self._address, browser):
            head.addWidget(each)
        layout = QVBoxLayout(self)
        layout.addLayout(head)
        for each in (self._robot, self._table, self._told):
            layout.addWidget(each)

    @property
    def address(self) -> str:
        """The address of the live view."""
        return str(self._address.text())

    def open(self, address: str) -> None:
        """Show the live view of another address."""
        self._address.setText(address)
        self._connect()

    def stop(self) -> None:
        """Close the connection."""
        self._retry.stop()
        reply, self._reply = self._reply, None
        if reply is not None:
            reply.abort()

    def _connect(self) -> None:
        self.stop()
        self._shows(f"Connecting to {self.address}.", False)
        self._retry.start(SILENCE_MS)
        self._events = Events()
        url = QUrl(self.address).resolved(QUrl("api/events"))
        reply = self._reply = self._network.get(QNetworkRequest(url))
        reply.readyRead.connect(lambda: self._heard(reply))
        reply.finished.connect(lambda: self._lost(reply))

    def _heard(self, reply: QNetworkReply) -> None:
        if reply is not self._reply:
            return
        self._retry.start(SILENCE_MS)
        try:
            if self._events.feed(bytes(reply.readAll())):
                self._show(self._events.document)
        except (AttributeError, KeyError, TypeError, ValueError) as error:  # it would end rqt
            self.stop()
            self._shows(f"No live view of this version answers at {self.address}: {error!r}", False)

    def _lost(self, reply: QNetworkReply) -> None:
        reply.deleteLater()
        if reply is self._reply:
            self._reply = None
            self._shows(f"Not connected: {reply.errorString()}. Trying again.", False)
            self._retry.start(RETRY_MS)

    def _shows(self, text: str, now: bool) -> None:
        """Say how the robot is; the table is grey while it is not of now."""
        self._robot.setText(text)
        self._table.setEnabled(now)

    def _show(self, document: Dict[str, Any]) -> None:
        self._shows(document["robot"]["text"], True)
        services = document["services"]
        for name in set(self._rows) - set(services):
            self._table.takeTopLevelItem(self._table.indexOfTopLevelItem(self._rows.pop(name)))
        for place, name in enumerate(ordered(services, Sort.STATE)):
            self._show_row(place, name, services[name])
        states = {name: row["state"] for name, row in services.items()}
        if states != self._states:
            self._states = states
            for column in range(len(COLUMNS)):
                self._table.resizeColumnToContents(column)
        self._tell(self._table.currentItem())

    def _show_row(self, place: int, name: str, row: Dict[str, Any]) -> None:
        item = self._rows.setdefault(name, QTreeWidgetItem())
        if self._table.topLevelItem(place) is not item:
            current = self._table.currentItem()
            self._table.takeTopLevelItem(self._table.indexOfTopLevelItem(item))
            self._table.insertTopLevelItem(place, item)
            self._table.setCurrentItem(current)
        rate = "" if row["rate"] is None else f"{row['rate']:.1f} Hz"
        values = ", ".join(f"{each} {value(prop)}" for each, prop in row["properties"].items())
        state = row["state"].replace("_", " ")
        for column, text in enumerate((state, name, values, row["publisher"] or "", rate)):
            if item.text(column) != text:
                item.setText(column, text)
        item.setForeground(0, COLOURS.get(row["state"], self.palette().windowText().color()))

    def _tell(self, item: Optional[QTreeWidgetItem], *_: Any) -> None:
        services = self._events.document.get("services", {})
        row = services.get(item.text(1)) if item is not None else None
        self._told.setText("\n".join(told(row)) if row else "")


def told(row: Dict[str, Any]) -> List[str]:
    """Return what is to be said of a service: why it is as it is, and what to do."""
    why = [row["why"] or row["detail"] or "Nothing is wrong with it."]
    remedies = [" ".join((each["text"], each["command"])) for each in row["remedies"]]
    return [*why, f"If its node fails, it {row['fate']}" if row["fate"] else "", *remedies]
