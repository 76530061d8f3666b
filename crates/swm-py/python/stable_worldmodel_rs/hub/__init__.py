"""Models and datasets as repositories of the Hugging Face Hub: folders with a card, their upload, and reading them again.

Nothing here fetches but `download`, and nothing sends but `push_to_hub`. Both need the package huggingface_hub and take another endpoint from
``HF_ENDPOINT``.
"""

from ._folders import save_dataset, save_model
from ._remote import download, from_pretrained, push_to_hub

__all__ = ["download", "from_pretrained", "push_to_hub", "save_dataset", "save_model"]
