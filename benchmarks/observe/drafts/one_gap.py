import sys; pass
from p import *
k,kind=int(sys.argv[1]),sys.argv[2]
um = (10.0, 20.0, 40.0)[k % 3]; layout, size = painter.LAYOUTS[(k // 2) % 4], 4.0 if um < 15 else 6.0
p,L,s,t=run(FIRST_FAULTY+k,kind,layout,um,size,LENGTHS_MM[k%3:])
w=L.drawn.ways
print("scale",L.view.scale,"px/mm",L.view.px_per_mm,"gaps",p.gaps)
for st,a,e in p.gaps:
    r=np.flatnonzero((w.stroke==st)&(w.along>a-.3)&(w.along<e+.3))
    for i in r: print(f"{w.along[i]-a:6.2f} {'*' if a<w.along[i]<e else ' '} share {L.shares.share[i]:.2f} off {L.shares.offset[i]:.2f} wid {L.shares.wider[i]:.2f} mis {L.misfit[i]:.1f} st {np.round(L.states[i],3)}")
print(np.round(L.drawn.model.profile[0,0],2).T)
