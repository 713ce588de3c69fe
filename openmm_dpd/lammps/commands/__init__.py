"""Commands: functions of the deck's state and the words after the command's name, registered by :func:`command` in ``setup.py``."""
