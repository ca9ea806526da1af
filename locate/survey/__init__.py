"""Many flights, one map: where columns of air rise, how often, and what was not covered."""
