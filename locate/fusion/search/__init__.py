"""Where columns of evidence stand in the scene, and how strong chance makes them."""
