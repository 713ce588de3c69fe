"""Files that decks read and write: data files, restart files, tables, equations of state."""
