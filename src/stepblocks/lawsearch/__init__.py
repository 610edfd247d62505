"""Trace residuals of any forward model to effects that the model lacks.

The package knows no field: a model is whatever has the methods of `forward_model.ForwardModel`. It
imports nothing of this project but its errors. Its modules follow one another:

1. What is given: `law` (effects with their parameters) and `forward_model` (trials and the model).
2. What trials scatter by: `scatter` (how much), `noise` (whitening, and errors that trials share).
3. Fits: `problem` (model, trials, noise; a fit), `objective` (residuals and Jacobian), `fit`.
4. One step of a search: `directions` (how effects show to first order), `gate` (whether there is
   any effect at all), `choice` (full fits of the best candidates, and their rivals).
5. What no column describes: `walk` (random walks and levels), `structure` (groups of trials, and
   neighbours that err together), `run_order` (effects along the run), `mixture` (bad trials).
6. What is found: `adequacy` (tests of what is left), `findings` (verdicts and results), `search`
   (steps until nothing is left), `judge` (what may be claimed), `explain` (all of it in one call).
7. What holds on other trials: `holdout` (held-out trials), `claims` (what they leave of a claim).
8. What to ask next: `identifiability` (what a design cannot tell apart), `discrimination` (settings
   that would).
"""
