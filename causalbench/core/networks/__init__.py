"""Neural networks as plain lists of tensors, many side by side."""
