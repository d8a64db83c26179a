"""A lens in a page of the browser: what it does to a plate, while it is turned.

turned             what the page may turn, and the options of `apply` that say the same
controls           which controls the page shows, from where knobs are defined
proxy, shown       a smaller plate for a first look; pictures as the screen shows them
view_transform     in place of sRGB, a display and a view of OpenColorIO
viewed_plate       a preset on a plate: pictures, plan, focus, start values
saved_settings     what was turned, in the shot's settings file
latest_wins        one thread that forgets what was asked before
guard, server      who may ask, and what they are answered
"""
