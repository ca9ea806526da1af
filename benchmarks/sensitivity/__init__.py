"""What is detected from a moving camera, by strength, views, arc, noise, nuisance and coding.

Scenes are random plants of seeds that nothing was trained on (310000 and on), filmed on an arc in
24 frames of 320x240 px (`--quick`) or 60 of 640x480 px. Poses are off by 0.03 degrees and 5 mm,
independently. The base case is 0.3 px, noise 1/255, an arc of 40 degrees, 8 key frames; each axis
changes one of these. A pixel is positive where |w| exceeds 0.3 of the plume's amplitude, negative
where it is below 0.01 px; sky is neither. The score is the llr. The ideal observer knows the scene,
the noise and the true w. `ideal` is its matched filter of w in a Gaussian window of 2 px, as wide
as what `registered` measures in, drawn from its own statistics; a network that knows the shape of
plumes looks further and may exceed it. Over the whole plume of one frame the matched filter has the
signal-to-noise ratio `whole_plume_snr`. A plume counts as found within 15 % of the
range; everything else that is reported is false. Medians over scenes.
"""
