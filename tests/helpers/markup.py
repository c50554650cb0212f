"""HTML of notebook views, as a browser would read it."""

from __future__ import annotations

from html.parser import HTMLParser


class Markup(HTMLParser):
    """Elements and attributes of a view, and the documents of its frames."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.text += data

    @property
    def frames(self) -> list[str]:
        return [value or "" for name, value in self.attributes if name == "srcdoc"]

    def check_inert(self) -> None:
        """Fail if the view itself has a script or a handler, or loads anything."""
        assert not {"script", "object", "embed", "link", "form", "base", "meta"} & set(self.tags)
        assert not [name for name, _ in self.attributes if name.startswith("on")]
        assert all(
            value.startswith("data:image/") for name, value in self.attributes if name == "src" and value
        )
        assert not [name for name, _ in self.attributes if name == "href"]
