"""Reading a deck and carrying out its runs."""
