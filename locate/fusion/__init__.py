"""Evidence of many views -> plumes: sum first, decide late."""
