"""The three experiments of the DYBS paper's section IV, with truth beside them.

Columns: magnitude error, the mean of ||answer| - |w||, beside the mean |w| (the paper's measure);
EPE over |w| > 0.06 px beside that of an answer of zero; r of both components there; AUROC of the
score, |w| > 0.06 px against |w| < 0.02 px; precision and recall of llr > 2; with evidence: share of
pixels that have any. Pixels of objects in front of the background count in none of them; `beside
objects` is the mean and the 99th percentile of the error within 16 px of one, px.
"""
