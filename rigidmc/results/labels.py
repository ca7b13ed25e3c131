"""Words and numbers as people read them on pictures, pages and tables."""


def count_text(count: int, noun: str) -> str:
    """ "1 member", "20,000 members"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
