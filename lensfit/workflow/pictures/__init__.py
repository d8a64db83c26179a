"""Pictures of takes: the photograph, the same as the model has it, what is left."""
