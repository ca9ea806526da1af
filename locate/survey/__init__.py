"""Many flights, one map: where columns of air rise, how often, and where nobody looked."""
