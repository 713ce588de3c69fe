"""Commands: each a function of the deck's state and the words after its name, entered in the table of ``setup.py`` by :func:`command`."""
