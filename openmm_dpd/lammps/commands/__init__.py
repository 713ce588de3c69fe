"""Tables of commands: ``{name: handler}``, each handler taking the deck's state and the words after the command.

A later command is one more entry of one of these tables.
"""
