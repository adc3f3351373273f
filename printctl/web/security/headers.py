"""Security headers of every response, such as the content security policy.

Scripts run only from our own files or with the page's nonce: a script in a file name or a G-code
comment that slipped into a page as HTML would not run. Vue compiles templates in the browser,
which needs ``unsafe-eval``; Quasar sets styles in the page, which needs ``unsafe-inline`` there.
"""

from __future__ import annotations

from typing import Final

_FIXED: Final = (
    (b"x-content-type-options", b"nosniff"),
    # No word to other servers; without any, a browser would call our own forms' origin "null".
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"x-frame-options", b"DENY"),
    (b"permissions-policy", b"geolocation=(), microphone=(), payment=()"),
)


def security_headers(nonce: str, sources: str) -> list[tuple[bytes, bytes]]:
    """Headers of one answer.

    Parameters
    ----------
    nonce : str
        Of the scripts in the page.
    sources : str
        Further places that scripts may speak to: the server's WebSocket and its stop process.
    """
    policy = "; ".join(
        (
            "default-src 'none'",
            f"script-src 'self' 'nonce-{nonce}' 'unsafe-eval'",
            "style-src 'self' 'unsafe-inline'",
            "img-src 'self' data: blob:",
            "media-src 'self' blob:",
            "font-src 'self' data:",
            "worker-src 'self' blob:",
            f"connect-src 'self' {sources}",
            "form-action 'self'",
            "base-uri 'none'",
            "frame-src 'self'",
            "frame-ancestors 'none'",
            "object-src 'none'",
        )
    )
    return [*_FIXED, (b"content-security-policy", policy.encode("ascii"))]
