// As much of CHAI3D 3.3 as ReleaseRing.h names, so that its law can be driven without hardware.
#ifndef CHAI3D_STUB_H
#define CHAI3D_STUB_H

#include <cmath>

namespace chai3d {

const double C_PI = 3.14159265358979323846;

class cVector3d
{
public:
    cVector3d(double x = 0.0, double y = 0.0, double z = 0.0) : m_x(x), m_y(y), m_z(z) {}
    double x() const { return m_x; }
    double z() const { return m_z; }
    double length() const { return std::sqrt(m_x * m_x + m_y * m_y + m_z * m_z); }
    void zero() { set(0.0, 0.0, 0.0); }
    double distance(const cVector3d& o) const { return (*this - o).length(); }
    void set(double x, double y, double z)
    {
        m_x = x;
        m_y = y;
        m_z = z;
    }
    cVector3d operator-(const cVector3d& o) const
    {
        return cVector3d(m_x - o.m_x, m_y - o.m_y, m_z - o.m_z);
    }
    cVector3d operator+(const cVector3d& o) const
    {
        return cVector3d(m_x + o.m_x, m_y + o.m_y, m_z + o.m_z);
    }
    friend cVector3d operator*(double s, const cVector3d& v)
    {
        return cVector3d(s * v.m_x, s * v.m_y, s * v.m_z);
    }

private:
    double m_x, m_y, m_z;
};

class cPrecisionClock
{
public:
    void start(bool) {}
    double getCurrentTimeSeconds() const { return 0.0; }
};

class cGenericObject
{
public:
    cVector3d getGlobalPos() const { return cVector3d(); }
};

inline cVector3d cProjectPointOnPlane(const cVector3d& point, const cVector3d&, const cVector3d&)
{
    return point;
}

struct cCollisionEvent
{
    cVector3d m_globalNormal;
    cGenericObject* m_object = nullptr;
};

struct cCollisionRecorder
{
    cCollisionEvent m_nearestCollision;
};

class cAlgorithmFingerProxy
{
public:
    virtual ~cAlgorithmFingerProxy() {}
    void setEpsilonBaseValue(double) {}

protected:
    virtual void computeNextBestProxyPosition(const cVector3d&) {}
    virtual void testFrictionAndMoveProxy(const cVector3d&, const cVector3d&, cVector3d&,
                                          cGenericObject*)
    {
    }
    cVector3d m_proxyGlobalPos, m_nextBestProxyGlobalPos;
    cCollisionRecorder m_collisionRecorderConstraint0;
    double m_radius = 1.0;
    unsigned int m_numCollisionEvents = 0, m_algoCounter = 0;
};

class cHapticPoint
{
public:
    cVector3d getGlobalPosGoal() const { return goal; }
    cVector3d getGlobalPosProxy() const { return proxy; }
    void initialize(const cVector3d&) {}
    cVector3d goal, proxy;
    cAlgorithmFingerProxy* m_algorithmFingerProxy = nullptr;
};

class cGenericEffect
{
public:
    explicit cGenericEffect(cGenericObject* parent) : m_parent(parent) {}
    virtual ~cGenericEffect() {}
    virtual bool computeForce(const cVector3d&, const cVector3d&, const unsigned int&,
                              cVector3d&) = 0;

protected:
    cGenericObject* m_parent;
};

class cMultiMesh : public cGenericObject
{
public:
    void setStiffness(double, bool) {}
    void setFriction(double, double, bool) {}
    void computeBoundaryBox(bool) {}
    void createAABBCollisionDetector(double) {}
    void addEffect(cGenericEffect*) {}
};

class cGenericTool
{
public:
    void setRadius(double, double) {}
    cVector3d getDeviceGlobalPos() const { return cVector3d(); }
    cHapticPoint* getHapticPoint(int) { return nullptr; }
};

}  // namespace chai3d
#endif
