"""Write docs/reference from the declarations. Run after any change to a model, effect, product or symbol."""

from pathlib import Path

from nearlift.describe import reference_pages

ROOT = Path(__file__).parent / "reference"


def main() -> None:
    """Write every page, and remove pages of what is no longer declared."""
    pages = reference_pages()
    for path in ROOT.rglob("*.md"):
        if path.relative_to(ROOT).as_posix() not in pages:
            path.unlink()
    for name, text in pages.items():
        path = ROOT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
