"""The commands that find delaminations: detect, excite, pod, infer."""
