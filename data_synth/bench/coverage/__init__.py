"""Whether stated deviations cover the truth: one shoot with noise drawn anew."""
