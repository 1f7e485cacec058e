!> Checks of the matrices and the names of a structure: what a builder or a caller may have given wrongly.
module hb_structure_checks
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrf
   use hb_name_table, only: name_table_t
   use hb_sparse, only: sparse_t
   use hb_text, only: to_text
   implicit none
   private
   public :: check_finite, check_mass, check_names, check_sizes, check_sparse_mass, label_length, unit_length

   integer, parameter :: label_length = 16                   !! longest name of a degree of freedom
   integer, parameter :: unit_length = 8

contains

   !> Size of a matrix in words, such as `3 x 4`.
   pure function shape_text(matrix) result(text)
      real(wp), intent(in) :: matrix(:, :)
      character(24) :: text

      text = to_text(size(matrix, 1))//" x "//to_text(size(matrix, 2))
   end function shape_text

   !> Fails unless all arguments are of `n_dofs` degrees of freedom.
   pure subroutine check_sizes(n_dofs, mass, damping, stiffness, labels, units, error)
      integer, intent(in) :: n_dofs
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)
      character(*), intent(in) :: labels(:), units(:)
      type(error_t), allocatable, intent(out) :: error

      if (n_dofs < 1) then
         call fail(error, "there are no degrees of freedom; at least 1 is needed")
      else if (any(shape(mass) /= n_dofs)) then
         call fail(error, "the mass matrix must be square, it is "//trim(shape_text(mass)))
      else if (any(shape(damping) /= n_dofs)) then
         call fail(error, "the damping matrix is "//trim(shape_text(damping))//", the mass matrix "// &
                   trim(shape_text(mass)))
      else if (any(shape(stiffness) /= n_dofs)) then
         call fail(error, "the stiffness matrix is "//trim(shape_text(stiffness))// &
                   ", the mass matrix "//trim(shape_text(mass)))
      else if (size(labels) /= n_dofs) then
         call fail(error, "there are "//to_text(size(labels))//" labels for "//to_text(n_dofs)// &
                   " degrees of freedom")
      else if (size(units) /= n_dofs) then
         call fail(error, "there are "//to_text(size(units))//" units for "//to_text(n_dofs)// &
                   " degrees of freedom")
      end if
   end subroutine check_sizes

   !> Fails if a label begins with no letter, is too long or given twice, or if a unit is empty or too long.
   pure subroutine check_names(labels, units, error)
      character(*), intent(in) :: labels(:), units(:)
      type(error_t), allocatable, intent(out) :: error
      character(*), parameter :: letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
      type(name_table_t) :: known
      integer :: i, position

      do i = 1, size(labels)
         position = known%find(labels(i))
         if (scan(labels(i) (1:1), letters) == 0) then
            call fail(error, "label "//to_text(i)//" is '"//trim(labels(i))// &
                      "', it must begin with a letter")
            return
         else if (len_trim(labels(i)) > label_length) then
            call fail(error, "label '"//trim(labels(i))//"' has more than "// &
                      to_text(label_length)//" characters")
            return
         else if (len_trim(units(i)) == 0 .or. len_trim(units(i)) > unit_length) then
            call fail(error, "unit '"//trim(units(i))//"' of "//trim(labels(i))// &
                      " must have 1 to "//to_text(unit_length)//" characters")
            return
         else if (position > 0) then
            call fail(error, "degrees of freedom "//to_text(position)//" and "//to_text(i)// &
                      " both have the label '"//trim(labels(i))//"'; labels must be unique")
            return
         end if
         call known%add(labels(i))
      end do
   end subroutine check_names

   !> Fails if an entry of a matrix is not finite.
   pure subroutine check_finite(name, matrix, labels, error)
      character(*), intent(in) :: name
      real(wp), intent(in) :: matrix(:, :)
      character(*), intent(in) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, j

      do j = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (ieee_is_finite(matrix(i, j))) cycle
            call fail(error, "the "//name//" between "//trim(labels(i))//" and "// &
                      trim(labels(j))//" is not a finite number")
            return
         end do
      end do
   end subroutine check_finite

   !> Fails unless the mass is symmetric and positive semi-definite up to rounding, in any mixture of units.
   subroutine check_mass(mass, labels, error)
      real(wp), intent(in) :: mass(:, :)
      character(*), intent(in) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: max_asymmetry = 1.0e-10_wp    ! matrices from text often have few digits
      real(wp), allocatable :: scaled(:, :), scale(:)
      integer :: i, info, j, n_dofs

      n_dofs = size(mass, 1)
      allocate (scaled(n_dofs, n_dofs), scale(n_dofs))
      do j = 1, n_dofs
         if (mass(j, j) < 0.0_wp) then
            call fail(error, "the mass of "//trim(labels(j))//" is negative: "// &
                      to_text(mass(j, j)))
            return
         end if
         scale(j) = sqrt(mass(j, j))
      end do
      do j = 1, n_dofs
         do i = 1, n_dofs
            if (.not. abs(mass(i, j)) > 0.0_wp .and. .not. abs(mass(j, i)) > 0.0_wp) then
               scaled(i, j) = 0.0_wp
               cycle
            else if (.not. scale(i)*scale(j) > 0.0_wp) then
               call fail(error, "the mass matrix is indefinite: "//trim(labels(i))//" and "// &
                         trim(labels(j))//" are coupled by mass, but not both have a mass of their own")
               return
            else if (abs(mass(i, j) - mass(j, i)) > max_asymmetry*scale(i)*scale(j)) then
               call fail(error, "the mass matrix must be symmetric; between "//trim(labels(i))// &
                         " and "//trim(labels(j))//" it is "//to_text(mass(i, j))// &
                         " one way and "//to_text(mass(j, i))//" the other")
               return
            end if
            scaled(i, j) = mass(i, j)/(scale(i)*scale(j))
         end do
         ! The shift lets a semi-definite matrix pass the Cholesky factorisation.
         scaled(j, j) = scaled(j, j) + 10*real(n_dofs, wp)*max_asymmetry
      end do

      call dpotrf("L", n_dofs, scaled, n_dofs, info)
      if (info > 0) then
         call fail(error, "the mass matrix is indefinite: a motion of the degrees of freedom "// &
                   "up to "//trim(labels(info))//" would have negative kinetic energy")
      end if
   end subroutine check_mass

   !> Fails unless the mass is symmetric, without negative diagonal entries, and with no entry larger than the
   !> diagonal permits.
   subroutine check_sparse_mass(mass, labels, error)
      type(sparse_t), intent(in) :: mass
      character(*), intent(in) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: max_asymmetry = 1.0e-10_wp
      real(wp), allocatable :: diagonal(:)
      integer :: e, i

      allocate (diagonal, source=mass%diagonal())
      do i = 1, mass%n_rows
         if (diagonal(i) < 0.0_wp) then
            call fail(error, "the mass of "//trim(labels(i))//" is negative: "//to_text(diagonal(i)))
            return
         end if
      end do
      do i = 1, mass%n_rows
         do e = mass%first(i), mass%first(i + 1) - 1
            associate (j => mass%column(e), m => mass%value(e))
               if (abs(m - mass%at(j, i)) > max_asymmetry*sqrt(diagonal(i)*diagonal(j))) then
                  call fail(error, "the mass matrix must be symmetric; between "//trim(labels(i))//" and "//trim(labels(j))// &
                            " it is "//to_text(m)//" one way and "//to_text(mass%at(j, i))//" the other")
               else if (abs(m) > (1.0_wp + max_asymmetry)*sqrt(diagonal(i)*diagonal(j))) then
                  call fail(error, "the mass matrix is indefinite: the mass between "//trim(labels(i))//" and "//trim(labels(j))// &
                            " is larger than their own")
               end if
            end associate
            if (allocated(error)) return
         end do
      end do
   end subroutine check_sparse_mass
end module hb_structure_checks
