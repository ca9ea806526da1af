"""A network trained on software warps reads their blur, and nothing else.

Every sample is made twice of one part of a photo and one plume. `camera`: seen through the plume as
a camera sees it. `bilinear`: taken without the plume, then warped by software, as the paper does.
The cameras of the two (shift by part of a pixel, blur, noise) are drawn alike, not equal.
Training samples come from the photos and runs of the training split, test samples from the photos
of the validation and the test split (nothing is chosen on either) and the runs of the test split.

One network is trained each way, with equal samples and steps; both are judged on both, and on
bilinear warps with noise added after them. Each answers the same: whether a pixel is displaced, and
by how much. The perceptron is as small as can read blur: fixed differences of neighbours at two
scales, their energies in two windows, and two hidden layers on their logarithms; it learns in
seconds. `lite` is the design of the shipped network at its width of 16; `paper` that of the paper,
8 channels wide at full resolution (64 take sixteen times as long); its two channels answer the two
questions. UNets see first samples that are moved by 0.4 px and more, or not at all, and then all.

Pixels as in `benchmarks.single_frame`: positive where |w| > 0.06 px, negative where |w| < 0.02 px.
"""
