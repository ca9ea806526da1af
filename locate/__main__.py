"""``python -m locate``: the same as the command ``locate``, which other programs are called too."""

from locate.cli import main

main()
