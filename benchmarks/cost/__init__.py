"""What running costs: a whole run, the choice of key frames, the synthesis of samples."""
