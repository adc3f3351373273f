"""Three hundred tissues, grown and judged by code that shares nothing with the product."""
