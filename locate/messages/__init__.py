"""What robots say: images, poses, transforms and camera parameters, live or from a bag."""
