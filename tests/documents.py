"""What users read: README.md and the pages of the guide, as text."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
README_PATH = ROOT / "README.md"
GUIDE = ROOT / "notebooks" / "guide"
README = README_PATH.read_text(encoding="utf-8")
PAGES = {path.name: path.read_text(encoding="utf-8") for path in GUIDE.glob("*.md")}
"""Pages of the guide by file name."""
EVERYTHING = "\n".join([README, *PAGES.values()])


def section(text: str, heading: str) -> str:
    """What stands below a heading, up to the next one of any level.

    Raises
    ------
    ValueError : No line of the text is that heading, or several are.
    """
    found = []
    inside = fenced = False
    for line in text.splitlines():
        fenced ^= line.startswith("```")
        if line.startswith("#") and not fenced:
            inside = line.lstrip("#").strip() == heading
            if inside:
                found.append([])
        elif inside:
            found[-1].append(line)
    if len(found) != 1:
        raise ValueError(f"{len(found)} sections are called {heading}")
    return "\n".join(found[0]) + "\n"
