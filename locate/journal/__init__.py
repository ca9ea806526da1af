"""What a command reports while it works: a log for programs, progress and costs for people."""
