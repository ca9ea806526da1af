"""The answer of a run: plumes and bearings, and the file map.json."""
