"""The axis of a plume: seen across each view, solved for from all of them."""
