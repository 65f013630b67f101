!> Cross-sections of layers, or of one layer that shears (theory.md, section 16): layers from below, continuous where they
!> meet. The middle of the base layer is the node line. A layer turns with the section, r = v' - g~, or, where it is a core, by
!> v' less its own shear angle g. So the middle of a layer moves along the axis by u - Z r + sum of a_j g_j.
module layered_section
  use kinds, only: half_digits, wp
  implicit none (type, external)
  private
  public :: set_up_section, shear_coefficient

  integer, parameter, public :: most_cores = 4   !! of a section: arrays of an element have this room

  !> One layer.
  type, public :: section_layer
    integer :: material = 0          !! its number
    logical :: follows = .false.     !! viscoelastic terms follow it
    integer :: core = 0              !! number among the cores, 0: it does not shear by itself
    real(wp) :: thickness = 0.0_wp   !! [m]
    real(wp) :: area = 0.0_wp        !! A [m2]
    real(wp) :: second = 0.0_wp      !! I about its own middle [m4]
    real(wp) :: turning = 0.0_wp     !! the same of its rotary inertia, which plain sections lack [m4]
    real(wp) :: height = 0.0_wp      !! Z of its middle above the node line [m]
    real(wp) :: density = 0.0_wp     !! [kg/m3]
    real(wp) :: young = 0.0_wp       !! E_R [Pa]
    real(wp) :: shear = 0.0_wp       !! G_R; of a section that shears times its shear coefficient [Pa]
    real(wp) :: ray_m = 0.0_wp       !! Rayleigh mass coefficient [1/s]
    real(wp) :: ray_k = 0.0_wp       !! Rayleigh stiffness coefficient [s]
  end type section_layer

  !> A section.
  type, public :: layered_section_model
    type(section_layer), allocatable :: layers(:)
    integer :: base = 1
    integer :: cores = 0
    logical :: shears = .false.              !! Timoshenko's section: all layers by one angle
    logical :: core_stretch = .false.        !! terms of a core follow its stretch and bending, too
    real(wp), allocatable :: arm(:, :)       !! (layers, cores) a: motion along the axis of a layer's middle by a core's angle [m]
    real(wp) :: axis = 0.0_wp                !! z_n, sum EAZ/sum EA [m]
    real(wp), allocatable :: axis_arm(:)     !! (cores) sum EA a/sum EA [m]
    real(wp) :: stretching = 0.0_wp          !! sum EA [N]
    real(wp) :: bending = 0.0_wp             !! EI about the axis, layers bonded [N m2]
  contains
    procedure :: stretched
  end type layered_section_model

contains

  !> Heights, arms and axis of a section whose layers, base and cores are known.
  pure subroutine set_up_section(s)
    type(layered_section_model), intent(inout) :: s
    integer :: l, j, n
    real(wp) :: middle                       ! of the base above the lower face [m]
    n = size(s%layers)
    middle = sum(s%layers(:s%base - 1)%thickness) + 0.5_wp*s%layers(s%base)%thickness
    do l = 1, n
      s%layers(l)%height = sum(s%layers(:l - 1)%thickness) + 0.5_wp*s%layers(l)%thickness - middle
    end do
    s%layers(s%base)%height = 0.0_wp
    s%cores = maxval(s%layers%core)
    allocate (s%arm(n, s%cores), source=0.0_wp)
    do j = 1, n
      if (s%layers(j)%core == 0) cycle
      do l = 1, n
        if (l == s%base .or. (j - s%base)*(l - s%base) < 0 .or. abs(j - s%base) > abs(l - s%base)) cycle
        s%arm(l, s%layers(j)%core) = sign(merge(0.5_wp, 1.0_wp, j == l .or. j == s%base)*s%layers(j)%thickness, &
                                          real(l - s%base, wp))
      end do
    end do
    associate (ea => s%layers%young*s%layers%area, z => s%layers%height)
      s%stretching = sum(ea)
      s%axis = sum(ea*z)/s%stretching
      s%axis_arm = matmul(ea, s%arm)/s%stretching
      s%bending = sum(s%layers%young*s%layers%second + ea*(z - s%axis)**2)
    end associate
  end subroutine set_up_section

  !> Whether bending stretches the node line or slides layers: the axial deformation cannot be left out.
  elemental logical function stretched(s)
    class(layered_section_model), intent(in) :: s
    stretched = s%cores > 0 .or. abs(s%axis) > half_digits*sum(s%layers%thickness)
  end function stretched

  !> Cowper's shear coefficient (J. Appl. Mech. 33, 1966) of a shape; of another word than these a rectangle's.
  pure real(wp) function shear_coefficient(shape, poisson, hollow) result(factor)   ! [-]
    character(*), intent(in) :: shape        !! `rectangle`, `circle` or `tube`
    real(wp), intent(in) :: poisson          !! Poisson's ratio [-]
    real(wp), intent(in) :: hollow           !! inner over outer diameter [-]
    real(wp) :: m2
    if (shape == 'circle' .or. shape == 'tube') then
      m2 = hollow**2
      factor = 6*(1 + poisson)*(1 + m2)**2/((7 + 6*poisson)*(1 + m2)**2 + (20 + 12*poisson)*m2)
    else
      factor = 10*(1 + poisson)/(12 + 11*poisson)
    end if
  end function shear_coefficient
end module layered_section
