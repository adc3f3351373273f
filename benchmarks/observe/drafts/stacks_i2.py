import sys; pass
from h import *
import tests.registration.inspection.test_before as T
def along(st,lo,hi):
    L,w=last['look'],last['ways']; why=S._reasons(L,w,L.states[:,2]>.5)
    for k in np.flatnonzero((w.stroke==st)&(w.along>lo)&(w.along<hi)):
        print(f"  {w.along[k]:.2f} sh {L.shares.share[k]:.2f} mf {L.misfit[k]:.1f}/{L.noise.misfit_full[k,0]:.1f} st {L.states[k].round(2)} why {why[k]}")
for seed in (T.SEEN,1,2,3,5,6):
  for kind in ('opaque','translucent'):
    try: s=T.stack(seed,kind,gaps=2)
    except Exception as e: print(seed,kind,repr(e)); continue
    f=T.look(s)
    base=1000*min(3,len(s.older))
    st=f.stations
    print(seed,kind,'seen',round(f.seen_share,2),'true',[(base+k,round(b,2),round(e,2)) for k,b,e in s.gaps],'found',[(g.stroke,round(g.from_mm,2),round(g.to_mm,2)) for g in f.gaps], 'seen in gaps', [round(float(st.seen[(st.stroke==base+k)&(st.along_mm>b)&(st.along_mm<e)].mean()),2) for k,b,e in s.gaps], 'moved', round(f.moved_px,2))
    if seed==T.SEEN and kind=='opaque':
        for k,b,e in s.gaps: along(base+k,b-.2,e+.2)
