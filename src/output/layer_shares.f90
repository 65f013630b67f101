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
    integer :: k
    associate (list => damping_layers(m))
      names = [character(64) :: (trim(m%s%bodies(list(1, k))%name)//'.layer'//to_text(list(2, k))//'.energy[-]', &
                                 trim(m%s%bodies(list(1, k))%name)//'.layer'//to_text(list(2, k))//'.loss[-]', k=1, size(list, 2))]
    end associate
  end function share_names

  !> The columns of one mode; 0 where nothing is stored or lost.
  function shares(m, q, x, s) result(values)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)              !! (nq) state about which the mode is [m, rad]
    complex(wp), intent(in) :: x(:)           !! (nq) the mode, unknowns of the linearisation [m, rad]
    complex(wp), intent(in) :: s              !! its pole [1/s]
    real(wp), allocatable :: values(:)        !! [-]
    complex(wp), allocatable :: part(:, :)    ! (0:layers, bodies) of each layer, 0: of the rest [J]
    integer :: b, k
    associate (list => damping_layers(m))
      allocate (values(0))
      if (size(list) == 0) return
      allocate (part(0:maxval(list(2, :)), size(m%s%bodies)), source=(0.0_wp, 0.0_wp))
      do b = 1, size(m%s%bodies)
        associate (body => m%s%bodies(b), i => m%s%qo(b) + 3)
          if (body%flexible) call add_body(body, q(i + 1:i + body%nf), x(i + 1:i + body%nf), s, part(:, b))
        end associate
      end do
      values = [(over(real(part(list(2, k), list(1, k))), sum(real(part))), &
                 over(aimag(part(list(2, k), list(1, k))), sum(aimag(part))), k=1, size(list, 2))]
    end associate
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

  !> Body and layer of what terms follow in some element; of one layer alone the share says nothing.
  pure function damping_layers(m) result(list)
    type(mechanism_model), intent(in) :: m
    integer, allocatable :: list(:, :)        !! (2, layers)
    integer :: b, l, k, most
    logical :: damps
    allocate (list(2, 0))
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b))
        if (.not. body%flexible .or. size(body%segments) == 0) cycle
        most = maxval([(size(body%layers%sections(k)%layers), k=1, size(body%layers%sections))])
        do l = 1, merge(most, 0, most > 1)
          damps = any([(any(body%layers%kinds(k)%layer == l .and. body%layers%kinds(k)%material > 0), k=1, &
                        size(body%layers%kinds))])
          if (damps) list = reshape([list, b, l], [2, size(list, 2) + 1])
        end do
      end associate
    end do
  end function damping_layers
end module layer_shares
