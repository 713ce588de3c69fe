"""What a notebook shows of an object: a small table."""

from collections.abc import Mapping
from html import escape


def fact_table(title: str, facts: Mapping[str, object]) -> str:
    """An HTML table of names and values; None leaves a row out."""
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in facts.items() if value is not None)
    return f"<table><caption>{escape(title)}</caption>{''.join(rows)}</table>"
