"""Photometric files of luminaires as intensity tables: IES LM-63 (.ies) and EULUMDAT (.ldt).

Both are CIE type C: gamma 0 points down from a luminaire as it is measured (nadir), gamma is the
angle from there, and C planes turn counter-clockwise for someone who looks down on the luminaire.
`tracer.light.IntensityGrid` says how a source in a scene is turned.
"""
