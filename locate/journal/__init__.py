"""What a command says while it works: a log for programs, progress and costs for people."""
