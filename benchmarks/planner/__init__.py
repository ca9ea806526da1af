"""What `locate plan` says of random set-ups, against what the simulator shows of them."""
