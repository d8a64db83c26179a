"""A page in the browser that shows a lens, a plate or a shoot while knobs are adjusted.

lens_adjustments   what the page may adjust, the options of `apply` for the same, saving
screen_picture     a frame, and smaller ones for a quick look, as the screen shows them
viewed_lens        data of the page of a lens; its curves are in `lens_curves`
viewed_plate       a preset on a plate: pictures, plan, focus, start values
viewed_shoot       a shoot's photographs, its file (`shoot_form`), its `calibration_run`
viewed_results     a folder of results
answers            one thread that drops outdated requests
..._server         what each page is answered, over HTTP, by the `loopback_server`
"""
