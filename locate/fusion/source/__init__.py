"""One plume measured: where along its axis it begins, and its shape."""
