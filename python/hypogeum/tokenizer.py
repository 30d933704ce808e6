"""Vocabularies stored in a checkpoint's folder, with the calling convention of transformers."""

import logging
from pathlib import Path

import torch

from .mapping import MappingError

SENTENCEPIECE, JSON = "tokenizer.model", "tokenizer.json"
# Token that starts a text in Gemma's vocabulary.
START = "<bos>"

log = logging.getLogger("hypogeum")


class Tokenizer:
    """Maps texts to token numbers.

    Args:
        encode: Function that returns the numbers of a text, including that of the start token if there is one.
        size: Number of tokens.
    """

    def __init__(self, encode, size):
        self.encode = encode
        self.size = size
        self._has_warned = False

    @classmethod
    def from_sentencepiece(cls, model):
        """Return the tokenizer of a serialized SentencePiece model whose texts begin with its start token."""
        import sentencepiece

        pieces = sentencepiece.SentencePieceProcessor(model_proto=model)
        return cls(lambda text: [pieces.bos_id(), *pieces.encode(text)], pieces.vocab_size())

    @classmethod
    def from_json(cls, text):
        """Return the tokenizer of a `tokenizer.json` of the tokenizers package."""
        import tokenizers

        tokenizer = tokenizers.Tokenizer.from_str(text)
        tokenizer.no_truncation()
        tokenizer.no_padding()
        start = tokenizer.token_to_id(START)

        def encode(text):
            numbers = tokenizer.encode(text).ids
            return numbers if start is None or numbers[:1] == [start] else [start, *numbers]

        return cls(encode, tokenizer.get_vocab_size())

    def __call__(
        self, texts, max_length, padding="max_length", padding_side="right", truncation=True, return_tensors="pt"
    ):
        """Return `input_ids` and `attention_mask`, `[n_texts, n_tokens] i64`."""
        rows = [self.encode(text) for text in texts]
        if truncation:
            self._warn(texts, rows, max_length)
            rows = [row[:max_length] for row in rows]
        width = max([len(row) for row in rows] + ([] if padding == "longest" else [max_length]))
        tokens = torch.zeros(len(rows), width, dtype=torch.long)
        mask = torch.zeros(len(rows), width, dtype=torch.long)
        for idx, row in enumerate(rows):
            first = width - len(row) if padding_side == "left" else 0
            tokens[idx, first : first + len(row)] = torch.tensor(row)
            mask[idx, first : first + len(row)] = 1
        return dict(input_ids=tokens, attention_mask=mask)

    def _warn(self, texts, rows, max_length):
        """Warn about the first text that is cut off."""
        longest = max(range(len(rows)), key=lambda idx: len(rows[idx]))
        if self._has_warned or len(rows[longest]) <= max_length:
            return
        self._has_warned = True
        log.warning(
            "prompts are cut off at %d tokens (max_length of the tokenizer step); their ends are lost, and with them "
            "the state and the mark of the actions if they stand there: %r has %d tokens",
            max_length,
            texts[longest],
            len(rows[longest]),
        )


def read_tokenizer(folder):
    """Return the `Tokenizer` in a checkpoint's folder, or None if there is none.

    Raises:
        MappingError: The file cannot be read.
    """
    for name in (SENTENCEPIECE, JSON):
        path = Path(folder) / name
        if not path.is_file():
            continue
        try:
            if name == SENTENCEPIECE:
                return Tokenizer.from_sentencepiece(path.read_bytes())
            return Tokenizer.from_json(path.read_text())
        except ImportError as error:
            raise MappingError(f"{path} needs the package {error.name}: pip install {error.name}") from error
        # Both packages raise plain exceptions.
        except Exception as error:
            raise MappingError(f"{path} is not a vocabulary: {error}") from error
    return None
