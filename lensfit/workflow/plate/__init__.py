"""What a plate holds, without a lens: header, channels, depth, mattes, layers."""
