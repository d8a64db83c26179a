"""A page in the browser that shows a lens or a plate while knobs are adjusted.

lens_adjustments   what the page may adjust, and the options of `apply` for the same
controls           the controls of the page, from the definitions of the knobs
proxy              a smaller plate for a quick look
screen_picture     pictures as the screen shows them
view_transform     in place of sRGB, a display and a view of OpenColorIO
viewed_plate       a preset on a plate: pictures, plan, focus, start values
saved_settings     adjustments in the settings file of the shot
saved_edit         knobs as an edit of a lens of the library
answers            one thread that drops outdated requests
guard              which requests are accepted
"""
