"""The Design page's parts: the recipe's editor, making, looking, comparing."""
