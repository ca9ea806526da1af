"""The commands of the command line, a module each: thin skins over the library."""
