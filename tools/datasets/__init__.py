"""Readers of the paper's datasets, for people who have them; nothing of them is kept in this repository.

All of them give :class:`tools.datasets.exposure.Exposure`, and ``python -m tools.datasets`` turns any into
the formats of :mod:`tools.datasets.testset` (to measure on) and :mod:`tools.datasets.shards` (to train on).

====================  =============================================  ===================================
dataset               licence, as its owners state it                layout that is read
====================  =============================================  ===================================
SceneFlow Monkaa and  "for research purposes only [...] any          ``frames_cleanpass`` (or
Driving (Mayer et     commercial use is prohibited"; cite CVPR 2016  ``frames_finalpass``, each also
al., CVPR 2016)       (lmb.informatik.uni-freiburg.de)               ``..._webp``), ``optical_flow``,
                                                                     ``camera_data``
GoPro (Nah et al.,    CC BY 4.0 (seungjunnah.github.io)              ``GOPRO_Large_all`` and
CVPR 2017)                                                           ``GOPRO_Large``
RBI (Zhong et al.,    none is stated beside the download             ``Blur``, ``Sharp``
CVPR 2023)            (github.com/zzh-tech/BiT): ask its authors
====================  =============================================  ===================================

Check the licence where you download: weights trained on the first must not be sold, and are not ours.
"""
