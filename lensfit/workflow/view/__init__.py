"""A page in the browser that shows a lens or a plate while knobs are adjusted.

lens_adjustments   what the page may adjust, and the options of `apply` for the same
controls           the controls of the page, from the definitions of the knobs
read_plate         one frame, and smaller ones for a quick look
screen_picture     pictures as the screen shows them
view_transform     in place of sRGB, a display and a view of OpenColorIO
viewed_plate       a preset on a plate: pictures, plan, focus, start values
saved_adjustments  in the settings file of the shot, or as an edit of the library's lens
answers            one thread that drops outdated requests
guard              which requests are accepted
"""
