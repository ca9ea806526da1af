"""Messages of robots: images, poses, transforms and camera parameters, live or from a bag."""
