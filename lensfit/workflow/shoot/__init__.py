"""What was photographed: the shoot file, its takes and its charts."""
