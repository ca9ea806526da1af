"""Training of the networks; the only place, with `detect/dybs` training code, that knows torch."""
