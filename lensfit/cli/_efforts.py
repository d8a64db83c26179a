"""Names of the settings of the accuracy knob; `fit.wavefront.effort` says what each
means, and is not imported for the help alone."""

EFFORTS = ("fastest", "fast", "normal", "best")
EFFORT_HELP = " | ".join(EFFORTS)
