"""What the benchmark compares with: the same, as a competent programmer writes it with other means."""
