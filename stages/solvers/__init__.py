"""Ways to choose k of n candidates so that features and mutual distances match those of the shots."""
