"""What a camera could see of a plume, before anything is filmed."""
