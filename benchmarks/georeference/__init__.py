"""Scale, rotation and place of flights: the fit alone, and after structure from motion."""
