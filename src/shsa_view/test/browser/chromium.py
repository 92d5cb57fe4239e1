"""A headless Chromium that tests drive; they are skipped where there is none."""
from shutil import which
from typing import Any, Dict, List

import pytest

from shsa_testing.waiting import wait_until

BROWSER, DRIVER = which("chromium"), which("chromedriver")
WAIT_S = 15.0
OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")
WIDE = (1280, 900)
PHONE = (360, 740)
CONTRAST = 4.5
"""WCAG 2.1 AA, of text."""
PALE = """[...document.querySelectorAll('main *, header *, dialog *')].flatMap((element) => {
  const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  if (!own || !element.checkVisibility({checkOpacity: true}) || element.closest('svg')) return [];
  if (element.getBoundingClientRect().width < 2) return [];
  const numbers = (text) => text.match(/[0-9.]+/g).map(Number);
  const light = (color) => {
    const [r, g, b] = numbers(color).map((part) => {
      const value = part / 255;
      return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  let behind = element;
  const clear = (each) => numbers(getComputedStyle(each).backgroundColor)[3] === 0;
  while (behind.parentElement && clear(behind)) behind = behind.parentElement;
  const [one, other] = [getComputedStyle(element).color,
    getComputedStyle(behind).backgroundColor].map(light).sort((a, b) => b - a);
  const contrast = (one + 0.05) / (other + 0.05);
  return contrast < arguments[0] ? [`${element.textContent}: ${contrast.toFixed(2)}`] : [];
})"""
"""Texts of too little contrast, each with how much it has."""
OUTSIDE = """[...document.querySelectorAll('.values > div > *')].flatMap((element) => {
  const own = element.getBoundingClientRect();
  const cell = element.closest('td').getBoundingClientRect();
  return own.right > cell.right || own.left < cell.left ? [element.textContent] : [];
})"""
"""Names and values that reach beyond their column."""

Log = List[Dict[str, Any]]


class Browser:
    """One page at a time."""

    def __init__(self) -> None:
        pytest.importorskip("selenium", reason="no python3-selenium on this system")
        from selenium import webdriver
        from selenium.webdriver.chrome import service

        if not BROWSER or not DRIVER:
            pytest.skip("no chromium and chromium-driver on this system, or only as a snap")
        options = webdriver.ChromeOptions()
        options.binary_location = BROWSER
        for option in OPTIONS:
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self._said: Log = []  # and nobody was told yet
        self.driver = webdriver.Chrome(service=service.Service(DRIVER), options=options)
        self.size(*WIDE)

    def close(self) -> None:
        """End it."""
        self.driver.quit()

    def open(self, address: str) -> None:
        """Load a page, and wait until it shows a state."""
        self.log()
        self.driver.get("about:blank")
        self.driver.get(address)
        self._said = self.log()
        if any("ERR_NETWORK_CHANGED" in each["message"] for each in self._said):
            # An interface of the computer came or went: Chromium ends what it loads.
            self._said = []
            self.driver.get(address)
        self.wait("document.documentElement.dataset.connection === 'live'")
        self.wait("document.querySelector('#rows tr') !== null")

    def size(self, width: int, height: int, scale: float = 1.0) -> None:
        """Set the size of the window in px."""
        metrics: Any = {"width": width, "height": height, "deviceScaleFactor": scale}
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", {**metrics, "mobile": width < 600}
        )

    def dark(self, dark: bool) -> None:
        """Set what the user prefers."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def run(self, script: str, *arguments: Any) -> Any:
        """Return the value of an expression."""
        return self.driver.execute_script(f"return {script}", *arguments)

    def wait(self, condition: str, seconds: float = WAIT_S) -> Any:
        """Wait until an expression is true; its value."""
        return wait_until(lambda: self.run(condition), seconds, condition)

    def text(self, selector: str) -> str:
        """Return the text of the first element of a selector."""
        found = self.run("document.querySelector(arguments[0])?.textContent ?? null", selector)
        assert found is not None, f"there is no {selector}"
        return str(found)

    def texts(self, selector: str) -> List[str]:
        """Return the texts of all elements of a selector."""
        script = "[...document.querySelectorAll(arguments[0])].map((each) => each.textContent)"
        return list(self.run(script, selector))

    def click(self, selector: str) -> None:
        """Click the middle of an element."""
        self.driver.find_element("css selector", selector).click()

    def press(self, *keys: str) -> None:
        """Press keys, wherever the focus is; the names are those of selenium's Keys."""
        names: Any = pytest.importorskip("selenium.webdriver.common.keys").Keys
        for key in keys:
            self.driver.switch_to.active_element.send_keys(getattr(names, key))

    def focused(self) -> str:
        """Return the id, the service or the text of what has the focus."""
        return str(
            self.run(
                "document.activeElement.id || document.activeElement.closest('tr')?.dataset.service"
                " || document.activeElement.textContent"
            )
        )

    def count(self) -> None:
        """Count what the pages' code does that are opened from now on."""
        self.driver.execute_cdp_cmd("Profiler.enable", {})
        options = {"callCount": True, "detailed": True}
        self.driver.execute_cdp_cmd("Profiler.startPreciseCoverage", options)

    def counted(self) -> int:
        """Return how often any block of our code has run since it was asked last."""
        scripts = self.driver.execute_cdp_cmd("Profiler.takePreciseCoverage", {})["result"]
        functions = [f for each in scripts if "/static/" in each["url"] for f in each["functions"]]
        return sum(block["count"] for function in functions for block in function["ranges"])

    def count_no_more(self) -> None:
        """Let code run at its own speed again."""
        self.driver.execute_cdp_cmd("Profiler.disable", {})

    def log(self) -> Log:
        """Return the complaints of the browser since the last call."""
        said, self._said = [*self._said, *self.driver.get_log("browser")], []
        return said
