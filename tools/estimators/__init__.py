"""Other estimators of F: baselines, references, the paper's."""
