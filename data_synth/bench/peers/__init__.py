"""What a user has without lensfit, fitted to the same photographs of dots."""
