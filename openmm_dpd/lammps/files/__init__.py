"""Files that decks name: data files, tables, equations of state."""
