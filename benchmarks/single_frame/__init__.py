"""What single-frame detectors see, and what adapting to a background brings."""
