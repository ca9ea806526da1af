"""What single-frame detectors see, on samples that nothing was trained, chosen or calibrated on.

A pixel is positive where |w| > 0.06 px, negative where |w| < 0.02 px; those between are left out of
everything but the magnitude error. Every 5th row and column of a sample is looked at. Columns:
AUROC and average precision (AP) of the score, for dybs its llr before the bounds; EPE, the mean
length of the error over positives, beside that of an answer of zero; magnitude error, the mean of
||answer| - |w|| over all pixels of samples with a plume, beside the mean |w|; r, the correlation of
both components over positives; ECE, the expected calibration error of the stated probability, in 15
bins, where there is evidence; precision and recall of llr > 2, the default mask; with evidence, the
share of pixels that have any. The null knows the place in the frame and nothing else: the share
of positives there in the validation samples.
"""
