"""An event or a command in one short line."""
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from typing import Any, List

WIDTH = 110
TEXT_WIDTH = 60
ITEMS = 3


def in_short(value: Any) -> str:
    """The class and what its fields hold, as far as it says something; the time is left out."""
    words = [type(value).__name__, *_words(value)]
    return _cut(" ".join(words), WIDTH)


def _words(value: Any) -> List[str]:
    words = []
    for each in fields(value):
        content = getattr(value, each.name)
        usual = each.default is not MISSING and content == each.default
        if each.init and each.name != "time" and content is not None and not usual:
            words.append(_field(each.name, content))
    return [word for word in words if word]


def _field(name: str, content: Any) -> str:
    if isinstance(content, bool):
        return name if content else f"not {name}"
    text = _text(content)
    return f"{name}={text}" if isinstance(content, (int, float, tuple)) and text else text


def _text(content: Any) -> str:
    if isinstance(content, Enum):
        return str(content.value)
    if isinstance(content, float):
        return f"{content:.6g}"
    if isinstance(content, (tuple, list)):
        shown = [_text(each) for each in content[:ITEMS]]
        more = [f"+{len(content) - ITEMS}"] if len(content) > ITEMS else []
        return f"[{', '.join(shown + more)}]" if content else ""
    if is_dataclass(content):
        return f"({_cut(' '.join(_words(content)), TEXT_WIDTH)})"
    if hasattr(content, "__len__") and not isinstance(content, str):
        return f"{type(content).__name__} of {len(content)}"
    return _cut(" ".join(str(content).split()), TEXT_WIDTH)


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 3] + "..."
