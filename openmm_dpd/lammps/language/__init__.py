"""The language of decks: lines, words, arguments, formulas and variables."""
