"""Floor 1: cameras, poses, rays, grids, and how air bends light."""
