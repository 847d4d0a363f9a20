"""Training: targets, augmentation, matching, losses, and runs with Lightning."""
