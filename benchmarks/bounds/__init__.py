"""How far each step is from what its input allows: the Cramer-Rao bound, the ideal observer."""
