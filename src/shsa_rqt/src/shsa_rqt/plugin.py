"""The plugin, as rqt loads it."""
from typing import Any

from rqt_gui_py.plugin import Plugin

from shsa_rqt.widget import Widget

ADDRESS = "address"


class SelfHealing(Plugin):
    """Shows a live view; its address is kept with the perspective."""

    def __init__(self, context: Any) -> None:
        super().__init__(context)
        self.setObjectName("SelfHealing")
        self._widget = Widget()
        if context.serial_number() > 1:
            title = self._widget.windowTitle()
            self._widget.setWindowTitle(f"{title} ({context.serial_number()})")
        context.add_widget(self._widget)

    def shutdown_plugin(self) -> None:
        """Called by rqt: it is closed."""
        self._widget.stop()

    def save_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called by rqt."""
        instance_settings.set_value(ADDRESS, self._widget.address)

    def restore_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called by rqt once it is open."""
        self._widget.open(instance_settings.value(ADDRESS, self._widget.address))
