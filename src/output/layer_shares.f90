!> Shares of the viscoelastic layers of beams in the energy and in the loss of a mode (theory.md, section 16): of all that deforms
!> in bodies, x* K(s) x with each material's modulus at the pole s, the part of a layer.
module layer_shares
  use kinds, only: wp
  use body, only: body_model
  use element_law, only: rows_of
  use mechanism, only: mechanism_model
  use text, only: to_text
  implicit none (type, external)
  private
  public :: share_names, shares

contains

  !> Names of the columns: of each viscoelastic layer of each body with layers one of the energy and one of the loss.
  function share_names(m) result(names)
    type(mechanism_model), intent(in) :: m
    character(64), allocatable :: names(:)
    integer :: b, l
    allocate (names(0))
    do b = 1, size(m%s%bodies)
      do l = 1, layers_of(m%s%bodies(b))
        if (.not. damps(m%s%bodies(b), l)) cycle
        names = [character(64) :: names, trim(m%s%bodies(b)%name)//'.layer'//to_text(l)//'.energy[-]', &
                 trim(m%s%bodies(b)%name)//'.layer'//to_text(l)//'.loss[-]']
      end do
    end do
  end function share_names

  !> The columns of one mode; 0 where nothing is stored or lost.
  function shares(m, q, x, s) result(values)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)              !! (nq) state about which the mode is [m, rad]
    complex(wp), intent(in) :: x(:)           !! (nq) the mode, unknowns of the linearisation [m, rad]
    complex(wp), intent(in) :: s              !! its pole [1/s]
    real(wp), allocatable :: values(:)        !! [-]
    complex(wp), allocatable :: part(:, :)    ! (0:layers, bodies) of each layer, 0: of the rest [J]
    integer :: b, l, most
    most = 0
    do b = 1, size(m%s%bodies)
      most = max(most, layers_of(m%s%bodies(b)))
    end do
    allocate (values(0))
    if (most == 0) return
    allocate (part(0:most, size(m%s%bodies)), source=(0.0_wp, 0.0_wp))
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), i => m%s%qo(b) + 3)
        if (body%flexible) call add_body(body, q(i + 1:i + body%nf), x(i + 1:i + body%nf), s, part(:, b))
      end associate
    end do
    do b = 1, size(m%s%bodies)
      do l = 1, layers_of(m%s%bodies(b))
        if (damps(m%s%bodies(b), l)) values = [values, over(real(part(l, b)), sum(real(part))), over(aimag(part(l, b)), &
                                                                                                   sum(aimag(part)))]
      end do
    end do
  end function shares

  !> x/y, 0 where y is.
  pure real(wp) function over(x, y)   ! [-]
    real(wp), intent(in) :: x, y              !! [J]
    over = 0.0_wp
    if (abs(y) > 0.0_wp) over = x/y
  end function over

  !> Adds x* K(s) x of a body: of its elastic layers to entry 0, of each viscoelastic one to its own.
  subroutine add_body(body, q, x, s, part)
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: q(:)              !! (nf) [m, rad]
    complex(wp), intent(in) :: x(:)           !! (nf) [m, rad]
    complex(wp), intent(in) :: s              !! [1/s]
    complex(wp), intent(inout) :: part(0:)    !! [J]
    complex(wp) :: modulus(0:maxval([0, body%segments%material]))   ! over E_R [-]
    real(wp), allocatable :: energy(:)        ! rows squared [m2, rad2]
    integer, allocatable :: layer(:), material(:)
    integer :: e, i, r
    modulus = 1.0_wp
    do r = 1, size(body%segments)
      modulus(body%segments(r)%material) = 1 + body%segments(r)%law%ratio(s)
    end do
    do e = 1, body%ne
      associate (now => body%basis%element_coordinates(body, e, q), re => body%basis%element_coordinates(body, e, real(x, wp)), &
                 im => body%basis%element_coordinates(body, e, aimag(x)))
        energy = rows_of(body, e, re, now)**2 + rows_of(body, e, im, now)**2
      end associate
      layer = body%layers%kinds(body%layers%kind(e))%layer
      material = body%layers%kinds(body%layers%kind(e))%material
      do i = 1, size(energy)
        if (material(i) > ubound(modulus, 1)) material(i) = 0
        if (material(i) == 0 .or. layer(i) > ubound(part, 1)) layer(i) = 0
        part(layer(i)) = part(layer(i)) + modulus(material(i))*body%layers%kinds(body%layers%kind(e))%stiffness(i)*energy(i)
      end do
    end do
  end subroutine add_body

  !> Layers of a body's sections, 0: it has none.
  pure integer function layers_of(body) result(n)
    type(body_model), intent(in) :: body
    integer :: k
    n = 0
    if (.not. body%flexible) return
    do k = 1, size(body%layers%sections)
      n = max(n, size(body%layers%sections(k)%layers))
    end do
    if (n == 1) n = 0                         ! of one layer the share says nothing
  end function layers_of

  !> Whether terms follow a layer in some element.
  pure logical function damps(body, layer)
    type(body_model), intent(in) :: body
    integer, intent(in) :: layer
    integer :: k
    damps = .false.
    if (size(body%segments) == 0) return
    do k = 1, size(body%layers%kinds)
      damps = damps .or. any(body%layers%kinds(k)%layer == layer .and. body%layers%kinds(k)%material > 0)
    end do
  end function damps
end module layer_shares
