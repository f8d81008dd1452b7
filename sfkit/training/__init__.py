"""From a base and a training set to a source: fine-tuning that may stop anywhere and ends the same."""

from sfkit.training.settings import Augmentation, Precision, TrainingSettings
