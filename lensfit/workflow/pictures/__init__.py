"""Pictures of takes: the photograph, the model's rendering of it, and the residual."""
